<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips" labelsEnabled="0">
 <renderer-v2 type="categorizedSymbol" attr="verdict" symbollevels="0" forceraster="0" enableorderby="1">
  <categories>
   <category symbol="0" value="missing" label="Missing" render="true" />
   <category symbol="1" value="new" label="New" render="true" />
   <category symbol="2" value="wrong_type" label="Wrong type" render="true" />
   <category symbol="3" value="moved" label="Moved" render="true" />
   <category symbol="4" value="review" label="Review" render="true" />
   <category symbol="5" value="not_observable" label="Not observable" render="true" />
   <category symbol="6" value="unchanged" label="Unchanged" render="true" />
  </categories>
  <symbols>
   <symbol type="line" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="213,94,0,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.96" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="213,94,0,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.96" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="0,158,115,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.96" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="0,158,115,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.96" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="170,51,119,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.84" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="170,51,119,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.84" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="3" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="230,159,0,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.8" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="230,159,0,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.8" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="4" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="0,114,178,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.64" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="0,114,178,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.64" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="5" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="86,180,233,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.48" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="86,180,233,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.48" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="6" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="143,147,160,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.4" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="143,147,160,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.4" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
  </symbols>
  <orderby>
   <orderByClause asc="1" nullsFirst="1">CASE "verdict" WHEN 'unchanged' THEN 0 WHEN 'not_observable' THEN 1 WHEN 'review' THEN 2 WHEN 'moved' THEN 3 WHEN 'wrong_type' THEN 4 WHEN 'new' THEN 5 WHEN 'missing' THEN 6 ELSE 7 END</orderByClause>
  </orderby>
 </renderer-v2>
 <fieldConfiguration>
  <field name="verdict" configurationFlags="None">
   <editWidget type="ValueMap">
    <config>
     <Option type="Map">
      <Option name="map" type="List">
       <Option type="Map">
        <Option name="Unchanged" type="QString" value="unchanged" />
       </Option>
       <Option type="Map">
        <Option name="Not observable" type="QString" value="not_observable" />
       </Option>
       <Option type="Map">
        <Option name="Review" type="QString" value="review" />
       </Option>
       <Option type="Map">
        <Option name="Moved" type="QString" value="moved" />
       </Option>
       <Option type="Map">
        <Option name="Wrong type" type="QString" value="wrong_type" />
       </Option>
       <Option type="Map">
        <Option name="New" type="QString" value="new" />
       </Option>
       <Option type="Map">
        <Option name="Missing" type="QString" value="missing" />
       </Option>
      </Option>
     </Option>
    </config>
   </editWidget>
  </field>
 </fieldConfiguration>
 <aliases>
  <alias field="change_id" index="1" name="Change" />
  <alias field="verdict" index="2" name="Verdict" />
  <alias field="distance_m" index="3" name="Distance from NVDB's position (m)" />
  <alias field="distance_sigma_m" index="4" name="Standard deviation of the distance (m)" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="change_id" editable="0" />
  <field name="verdict" editable="0" />
  <field name="distance_m" editable="0" />
  <field name="distance_sigma_m" editable="0" />
 </editable>
 <previewExpression>"verdict" || ' ' || "change_id"</previewExpression>
 <mapTip enabled="1">&lt;b&gt;[% represent_value("verdict") %]&lt;/b&gt; &amp;nbsp; [% coalesce(to_string(round("distance_m", 2)) || ' m', '–') %] ± [% coalesce(to_string(round("distance_sigma_m", 2)) || ' m', '–') %] from NVDB's position
&lt;br&gt;&lt;small&gt;Change [% coalesce(nullif(replace(replace("change_id", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/small&gt;</mapTip>
</qgis>
