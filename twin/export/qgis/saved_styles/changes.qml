<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips|AttributeTable" labelsEnabled="1">
 <renderer-v2 type="categorizedSymbol" attr="verdict" symbollevels="0" forceraster="0" enableorderby="1">
  <categories>
   <category symbol="0" value="missing" label="Missing" render="true" />
   <category symbol="1" value="new" label="New" render="true" />
   <category symbol="2" value="wrong_type" label="Wrong type" render="true" />
   <category symbol="3" value="moved" label="Moved" render="true" />
   <category symbol="4" value="review" label="Review" render="true" />
   <category symbol="5" value="not_observable" label="Not observable" render="true" />
   <category symbol="6" value="unchanged" label="Unchanged" render="true" />
   <category symbol="7" value="" label="Other" render="true" />
  </categories>
  <symbols>
   <symbol type="marker" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="cross_fill" />
      <Option name="color" type="QString" value="213,94,0,255" />
      <Option name="size" type="QString" value="4.8" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
      <Option name="angle" type="QString" value="45" />
     </Option>
     <prop k="name" v="cross_fill" />
     <prop k="color" v="213,94,0,255" />
     <prop k="size" v="4.8" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
     <prop k="angle" v="45" />
     <data_defined_properties>
      <Option type="Map">
       <Option name="properties" type="Map">
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="4.8 * (0.8 + 0.4 * coalesce(&quot;confidence&quot;, 0.5)) * coalesce(if(@map_scale &lt; 400, scale_linear(@map_scale, 50, 400, 0.6, 1), scale_linear(@map_scale, 5000, 100000, 1, 0.5)), 1)" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="cross_fill" />
      <Option name="color" type="QString" value="0,158,115,255" />
      <Option name="size" type="QString" value="4.8" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
      <Option name="angle" type="QString" value="0" />
     </Option>
     <prop k="name" v="cross_fill" />
     <prop k="color" v="0,158,115,255" />
     <prop k="size" v="4.8" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
     <prop k="angle" v="0" />
     <data_defined_properties>
      <Option type="Map">
       <Option name="properties" type="Map">
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="4.8 * (0.8 + 0.4 * coalesce(&quot;confidence&quot;, 0.5)) * coalesce(if(@map_scale &lt; 400, scale_linear(@map_scale, 50, 400, 0.6, 1), scale_linear(@map_scale, 5000, 100000, 1, 0.5)), 1)" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="diamond" />
      <Option name="color" type="QString" value="170,51,119,255" />
      <Option name="size" type="QString" value="4.2" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
      <Option name="angle" type="QString" value="0" />
     </Option>
     <prop k="name" v="diamond" />
     <prop k="color" v="170,51,119,255" />
     <prop k="size" v="4.2" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
     <prop k="angle" v="0" />
     <data_defined_properties>
      <Option type="Map">
       <Option name="properties" type="Map">
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="4.2 * (0.8 + 0.4 * coalesce(&quot;confidence&quot;, 0.5)) * coalesce(if(@map_scale &lt; 400, scale_linear(@map_scale, 50, 400, 0.6, 1), scale_linear(@map_scale, 5000, 100000, 1, 0.5)), 1)" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="3" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="triangle" />
      <Option name="color" type="QString" value="230,159,0,255" />
      <Option name="size" type="QString" value="4" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
      <Option name="angle" type="QString" value="0" />
     </Option>
     <prop k="name" v="triangle" />
     <prop k="color" v="230,159,0,255" />
     <prop k="size" v="4" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
     <prop k="angle" v="0" />
     <data_defined_properties>
      <Option type="Map">
       <Option name="properties" type="Map">
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="4 * (0.8 + 0.4 * coalesce(&quot;confidence&quot;, 0.5)) * coalesce(if(@map_scale &lt; 400, scale_linear(@map_scale, 50, 400, 0.6, 1), scale_linear(@map_scale, 5000, 100000, 1, 0.5)), 1)" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="4" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="square" />
      <Option name="color" type="QString" value="0,114,178,255" />
      <Option name="size" type="QString" value="3.2" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
      <Option name="angle" type="QString" value="0" />
     </Option>
     <prop k="name" v="square" />
     <prop k="color" v="0,114,178,255" />
     <prop k="size" v="3.2" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
     <prop k="angle" v="0" />
     <data_defined_properties>
      <Option type="Map">
       <Option name="properties" type="Map">
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="3.2 * (0.8 + 0.4 * coalesce(&quot;confidence&quot;, 0.5)) * coalesce(if(@map_scale &lt; 400, scale_linear(@map_scale, 50, 400, 0.6, 1), scale_linear(@map_scale, 5000, 100000, 1, 0.5)), 1)" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="5" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="86,180,233,255" />
      <Option name="size" type="QString" value="2.4" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
      <Option name="angle" type="QString" value="0" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="86,180,233,255" />
     <prop k="size" v="2.4" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
     <prop k="angle" v="0" />
     <data_defined_properties>
      <Option type="Map">
       <Option name="properties" type="Map">
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="2.4 * (0.8 + 0.4 * coalesce(&quot;confidence&quot;, 0.5)) * coalesce(if(@map_scale &lt; 400, scale_linear(@map_scale, 50, 400, 0.6, 1), scale_linear(@map_scale, 5000, 100000, 1, 0.5)), 1)" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="6" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="143,147,160,255" />
      <Option name="size" type="QString" value="2" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
      <Option name="angle" type="QString" value="0" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="143,147,160,255" />
     <prop k="size" v="2" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
     <prop k="angle" v="0" />
     <data_defined_properties>
      <Option type="Map">
       <Option name="properties" type="Map">
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="2 * (0.8 + 0.4 * coalesce(&quot;confidence&quot;, 0.5)) * coalesce(if(@map_scale &lt; 400, scale_linear(@map_scale, 50, 400, 0.6, 1), scale_linear(@map_scale, 5000, 100000, 1, 0.5)), 1)" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="7" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="255,255,255,255" />
      <Option name="size" type="QString" value="3" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="0,0,0,255" />
      <Option name="outline_width" type="QString" value="0.4" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="255,255,255,255" />
     <prop k="size" v="3" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="0,0,0,255" />
     <prop k="outline_width" v="0.4" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
  </symbols>
  <orderby>
   <orderByClause asc="1" nullsFirst="1">CASE "verdict" WHEN 'unchanged' THEN 0 WHEN 'not_observable' THEN 1 WHEN 'review' THEN 2 WHEN 'moved' THEN 3 WHEN 'wrong_type' THEN 4 WHEN 'new' THEN 5 WHEN 'missing' THEN 6 ELSE 7 END</orderByClause>
  </orderby>
 </renderer-v2>
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="CASE WHEN &quot;verdict&quot; NOT IN ('unchanged', 'not_observable') AND @map_scale &lt;= 1500 THEN replace(&quot;sign&quot;, ' → ', '\n→ ') ELSE replace(CASE WHEN &quot;verdict&quot; IN ('unchanged', 'not_observable') THEN '' WHEN &quot;verdict&quot; = 'wrong_type' THEN &quot;skiltnummer_nvdb&quot; || ' → ' || &quot;skiltnummer_seen&quot; WHEN &quot;skiltnummer_seen&quot; &lt;&gt; '' THEN &quot;skiltnummer_seen&quot; ELSE &quot;skiltnummer_nvdb&quot; END, ';', ' + ') END" isExpression="1" fontFamily="Sans Serif" fontWeight="50" fontSize="9" fontSizeUnit="Point" textColor="34,34,34,255" textOpacity="1">
    <text-buffer bufferDraw="1" bufferSize="0.8" bufferSizeUnits="MM" bufferColor="255,255,255,255" bufferOpacity="1" />
   </text-style>
   <text-format autoWrapLength="36" useMaxLineLengthForAutoWrap="1" multilineAlign="0" />
   <placement placement="6" dist="1.5" distUnits="MM" offsetType="1" predefinedPositionOrder="TR,BR,R,TL,BL,L,TSR,BSR" />
   <rendering drawLabels="1" scaleVisibility="1" scaleMax="5000" scaleMin="0" />
  </settings>
 </labeling>
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
  <field name="nvdb_type" configurationFlags="None">
   <editWidget type="ValueMap">
    <config>
     <Option type="Map">
      <Option name="map" type="List">
       <Option type="Map">
        <Option name="Skiltpunkt" type="QString" value="95" />
       </Option>
       <Option type="Map">
        <Option name="Skiltplate" type="QString" value="96" />
       </Option>
      </Option>
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="decision" configurationFlags="None">
   <editWidget type="ValueMap">
    <config>
     <Option type="Map">
      <Option name="map" type="List">
       <Option type="Map">
        <Option name="Open" type="QString" value="open" />
       </Option>
       <Option type="Map">
        <Option name="Accept" type="QString" value="accept" />
       </Option>
       <Option type="Map">
        <Option name="Dismiss" type="QString" value="dismiss" />
       </Option>
       <Option type="Map">
        <Option name="Defer" type="QString" value="defer" />
       </Option>
      </Option>
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="reason" configurationFlags="None">
   <editWidget type="TextEdit">
    <config>
     <Option type="Map">
      <Option name="IsMultiline" type="bool" value="true" />
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="confidence" configurationFlags="None">
   <editWidget type="Range">
    <config>
     <Option type="Map">
      <Option name="AllowNull" type="bool" value="true" />
      <Option name="Min" type="double" value="0" />
      <Option name="Max" type="double" value="1000000" />
      <Option name="Precision" type="int" value="2" />
      <Option name="Step" type="double" value="0.01" />
      <Option name="Style" type="QString" value="SpinBox" />
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="distance_m" configurationFlags="None">
   <editWidget type="Range">
    <config>
     <Option type="Map">
      <Option name="AllowNull" type="bool" value="true" />
      <Option name="Min" type="double" value="0" />
      <Option name="Max" type="double" value="1000000" />
      <Option name="Precision" type="int" value="2" />
      <Option name="Step" type="double" value="0.01" />
      <Option name="Style" type="QString" value="SpinBox" />
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="distance_sigma_m" configurationFlags="None">
   <editWidget type="Range">
    <config>
     <Option type="Map">
      <Option name="AllowNull" type="bool" value="true" />
      <Option name="Min" type="double" value="0" />
      <Option name="Max" type="double" value="1000000" />
      <Option name="Precision" type="int" value="2" />
      <Option name="Step" type="double" value="0.01" />
      <Option name="Style" type="QString" value="SpinBox" />
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="comment" configurationFlags="None">
   <editWidget type="TextEdit">
    <config>
     <Option type="Map">
      <Option name="IsMultiline" type="bool" value="true" />
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="crop_face" configurationFlags="None">
   <editWidget type="ExternalResource">
    <config>
     <Option type="Map">
      <Option name="DocumentViewer" type="int" value="1" />
      <Option name="DocumentViewerWidth" type="int" value="0" />
      <Option name="DocumentViewerHeight" type="int" value="220" />
      <Option name="FileWidget" type="bool" value="false" />
      <Option name="FileWidgetButton" type="bool" value="false" />
      <Option name="RelativeStorage" type="int" value="2" />
      <Option name="StorageMode" type="int" value="0" />
      <Option name="PropertyCollection" type="Map">
       <Option name="name" type="QString" value="" />
       <Option name="properties" type="Map">
        <Option name="propertyRootPath" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="file_path(layer_property(@layer_id, 'path'))" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </Option>
    </config>
   </editWidget>
  </field>
  <field name="crop_wide" configurationFlags="None">
   <editWidget type="ExternalResource">
    <config>
     <Option type="Map">
      <Option name="DocumentViewer" type="int" value="1" />
      <Option name="DocumentViewerWidth" type="int" value="0" />
      <Option name="DocumentViewerHeight" type="int" value="220" />
      <Option name="FileWidget" type="bool" value="false" />
      <Option name="FileWidgetButton" type="bool" value="false" />
      <Option name="RelativeStorage" type="int" value="2" />
      <Option name="StorageMode" type="int" value="0" />
      <Option name="PropertyCollection" type="Map">
       <Option name="name" type="QString" value="" />
       <Option name="properties" type="Map">
        <Option name="propertyRootPath" type="Map">
         <Option name="active" type="bool" value="true" />
         <Option name="expression" type="QString" value="file_path(layer_property(@layer_id, 'path'))" />
         <Option name="type" type="int" value="3" />
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection" />
      </Option>
     </Option>
    </config>
   </editWidget>
  </field>
 </fieldConfiguration>
 <aliases>
  <alias field="change_id" index="1" name="Change" />
  <alias field="verdict" index="2" name="Verdict" />
  <alias field="reason" index="3" name="Reason" />
  <alias field="confidence" index="4" name="Confidence (0–1)" />
  <alias field="nvdb_type" index="5" name="NVDB object type" />
  <alias field="nvdb_id" index="6" name="NVDB id" />
  <alias field="nvdb_version" index="7" name="NVDB version" />
  <alias field="skiltnummer_nvdb" index="8" name="Sign code in NVDB" />
  <alias field="skiltnummer_seen" index="9" name="Sign code seen" />
  <alias field="distance_m" index="10" name="Distance from NVDB's position (m)" />
  <alias field="distance_sigma_m" index="11" name="Standard deviation of the distance (m)" />
  <alias field="drive_ids" index="12" name="Drives" />
  <alias field="n_sightings" index="13" name="Sightings" />
  <alias field="decision" index="14" name="Decision" />
  <alias field="cameras" index="15" name="Cameras" />
  <alias field="synced_at" index="16" name="Fetched from NVDB" />
  <alias field="software" index="17" name="Software" />
  <alias field="config_sha256" index="18" name="Settings (SHA-256)" />
  <alias field="sign" index="19" name="Sign" />
  <alias field="road" index="20" name="Road" />
  <alias field="comment" index="21" name="Comment" />
  <alias field="author" index="22" name="Decided by" />
  <alias field="crop_face" index="23" name="Picture of the sign" />
  <alias field="crop_wide" index="24" name="Picture of the place" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="change_id" editable="0" />
  <field name="verdict" editable="0" />
  <field name="reason" editable="0" />
  <field name="confidence" editable="0" />
  <field name="nvdb_type" editable="0" />
  <field name="nvdb_id" editable="0" />
  <field name="nvdb_version" editable="0" />
  <field name="skiltnummer_nvdb" editable="0" />
  <field name="skiltnummer_seen" editable="0" />
  <field name="distance_m" editable="0" />
  <field name="distance_sigma_m" editable="0" />
  <field name="drive_ids" editable="0" />
  <field name="n_sightings" editable="0" />
  <field name="decision" editable="1" />
  <field name="cameras" editable="0" />
  <field name="synced_at" editable="0" />
  <field name="software" editable="0" />
  <field name="config_sha256" editable="0" />
  <field name="sign" editable="0" />
  <field name="road" editable="0" />
  <field name="comment" editable="1" />
  <field name="author" editable="1" />
  <field name="crop_face" editable="0" />
  <field name="crop_wide" editable="0" />
 </editable>
 <attributetableconfig actionWidgetStyle="dropDown" sortOrder="0" sortExpression="CASE &quot;verdict&quot; WHEN 'missing' THEN 0 WHEN 'new' THEN 1 WHEN 'wrong_type' THEN 2 WHEN 'moved' THEN 3 WHEN 'review' THEN 4 WHEN 'not_observable' THEN 5 ELSE 6 END + 1 - coalesce(&quot;confidence&quot;, 0.5) / 2">
  <columns>
   <column type="field" name="verdict" width="110" hidden="0" />
   <column type="field" name="sign" width="230" hidden="0" />
   <column type="field" name="road" width="170" hidden="0" />
   <column type="field" name="reason" width="420" hidden="0" />
   <column type="field" name="decision" width="90" hidden="0" />
   <column type="field" name="comment" width="220" hidden="0" />
   <column type="field" name="author" width="100" hidden="0" />
   <column type="field" name="confidence" width="100" hidden="0" />
   <column type="field" name="distance_m" width="130" hidden="0" />
   <column type="field" name="nvdb_type" width="100" hidden="0" />
   <column type="field" name="nvdb_id" width="100" hidden="0" />
   <column type="field" name="skiltnummer_nvdb" width="110" hidden="0" />
   <column type="field" name="skiltnummer_seen" width="110" hidden="0" />
   <column type="field" name="n_sightings" width="90" hidden="0" />
   <column type="field" name="drive_ids" width="180" hidden="0" />
   <column type="field" name="cameras" width="180" hidden="0" />
   <column type="field" name="change_id" width="120" hidden="0" />
   <column type="field" name="fid" width="-1" hidden="1" />
   <column type="field" name="nvdb_version" width="-1" hidden="1" />
   <column type="field" name="distance_sigma_m" width="-1" hidden="1" />
   <column type="field" name="synced_at" width="-1" hidden="1" />
   <column type="field" name="software" width="-1" hidden="1" />
   <column type="field" name="config_sha256" width="-1" hidden="1" />
   <column type="field" name="crop_face" width="-1" hidden="1" />
   <column type="field" name="crop_wide" width="-1" hidden="1" />
   <column type="actions" width="-1" hidden="1" />
  </columns>
 </attributetableconfig>
 <labelOnTop>
  <field name="crop_face" labelOnTop="1" />
  <field name="crop_wide" labelOnTop="1" />
 </labelOnTop>
 <editorlayout>tablayout</editorlayout>
 <attributeEditorForm>
  <attributeEditorContainer name="Decide" columnCount="1" groupBox="1" showLabel="1" visibilityExpressionEnabled="0" visibilityExpression="">
   <attributeEditorField name="decision" index="14" showLabel="1" />
   <attributeEditorField name="comment" index="21" showLabel="1" />
   <attributeEditorField name="author" index="22" showLabel="1" />
  </attributeEditorContainer>
  <attributeEditorContainer name="Pictures" columnCount="2" groupBox="1" showLabel="1" visibilityExpressionEnabled="1" visibilityExpression="&quot;crop_face&quot; &lt;&gt; '' OR &quot;crop_wide&quot; &lt;&gt; ''">
   <attributeEditorField name="crop_face" index="23" showLabel="1" />
   <attributeEditorField name="crop_wide" index="24" showLabel="1" />
  </attributeEditorContainer>
  <attributeEditorContainer name="Finding" columnCount="1" groupBox="1" showLabel="1" visibilityExpressionEnabled="0" visibilityExpression="">
   <attributeEditorField name="verdict" index="2" showLabel="1" />
   <attributeEditorField name="sign" index="19" showLabel="1" />
   <attributeEditorField name="road" index="20" showLabel="1" />
   <attributeEditorField name="reason" index="3" showLabel="1" />
   <attributeEditorField name="confidence" index="4" showLabel="1" />
   <attributeEditorField name="distance_m" index="10" showLabel="1" />
   <attributeEditorField name="distance_sigma_m" index="11" showLabel="1" />
   <attributeEditorField name="n_sightings" index="13" showLabel="1" />
  </attributeEditorContainer>
  <attributeEditorContainer name="NVDB" columnCount="1" groupBox="1" showLabel="1" visibilityExpressionEnabled="0" visibilityExpression="">
   <attributeEditorField name="skiltnummer_nvdb" index="8" showLabel="1" />
   <attributeEditorField name="skiltnummer_seen" index="9" showLabel="1" />
   <attributeEditorField name="nvdb_type" index="5" showLabel="1" />
   <attributeEditorField name="nvdb_id" index="6" showLabel="1" />
   <attributeEditorField name="nvdb_version" index="7" showLabel="1" />
  </attributeEditorContainer>
  <attributeEditorContainer name="Origin" columnCount="1" groupBox="1" showLabel="1" visibilityExpressionEnabled="0" visibilityExpression="">
   <attributeEditorField name="change_id" index="1" showLabel="1" />
   <attributeEditorField name="drive_ids" index="12" showLabel="1" />
   <attributeEditorField name="cameras" index="15" showLabel="1" />
   <attributeEditorField name="synced_at" index="16" showLabel="1" />
   <attributeEditorField name="software" index="17" showLabel="1" />
   <attributeEditorField name="config_sha256" index="18" showLabel="1" />
  </attributeEditorContainer>
 </attributeEditorForm>
 <previewExpression>represent_value("verdict") || ': ' || "sign"</previewExpression>
 <mapTip enabled="1">&lt;div style="width: 420px; font-family: sans-serif"&gt;&lt;b&gt;[% represent_value("verdict") %]&lt;/b&gt; &amp;nbsp; [% coalesce(nullif(replace(replace("sign", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;&lt;small&gt;[% coalesce(nullif(replace(replace("road", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/small&gt;
&lt;br&gt;[% if("crop_face" &lt;&gt; '', '&lt;img height=150 src=''file:///' || regexp_replace(replace(replace(replace(replace(file_path(layer_property(@layer_id, 'path')), '%', '%25'), '#', '%23'), '?', '%3F'), '''', '%27'), '^/', '') || '/' || "crop_face" || '''&gt; ', '') %][% if("crop_wide" &lt;&gt; '', '&lt;img height=150 src=''file:///' || regexp_replace(replace(replace(replace(replace(file_path(layer_property(@layer_id, 'path')), '%', '%25'), '#', '%23'), '?', '%3F'), '''', '%27'), '^/', '') || '/' || "crop_wide" || '''&gt; ', '') %]
&lt;br&gt;[% coalesce(nullif(replace(replace("reason", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;&lt;small&gt;[% represent_value("decision") %][% if("author" &lt;&gt; '', ', ' || replace(replace("author", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), '') %][% if("comment" &lt;&gt; '', ': ' || replace(replace("comment", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), '') %]&lt;/small&gt;&lt;/div&gt;</mapTip>
</qgis>
